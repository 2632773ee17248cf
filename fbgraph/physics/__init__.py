"""What sensors are, by what they show: gravity at rest, fields that turn as the gyroscope says; no names."""
