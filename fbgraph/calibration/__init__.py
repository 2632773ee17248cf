"""A wearer and a device calibrated: step length, hard iron and gyroscope scale from walks between known places.

``legs`` says what a walk's steps tell of known lengths, ``wearer`` fits coefficients to them, ``device`` gathers what
walks showed of the device, ``calibrate`` does it all; ``calibrate_logs`` reads the logs and what is known of them.
"""
