"""From samples to steps: levelling, rests, step detection and measurement."""
