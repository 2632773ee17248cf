"""What the simulated sensors make of a walk: noise, bias, rates, iron."""
