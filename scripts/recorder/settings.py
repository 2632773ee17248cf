"""Where the recorder sends to: change this, then copy all of the folder to the stick."""

LINK = "serial"  # or "udp://192.168.1.5:5556", "tcp://192.168.1.5:5556": where fbgraph online listens
WIFI = ("name", "password")  # not for serial
