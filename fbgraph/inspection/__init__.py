"""What a log is, before anybody relies on it: how it was read, what its sensors show, what ``smooth`` would say.

``inspect_log`` composes it; what can be said is said of logs that cannot be smoothed, too.
"""
