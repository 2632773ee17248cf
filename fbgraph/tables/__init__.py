"""Tables: what a file, a folder or a zip of logs holds, as columns with names; no table knows what a sensor is."""
