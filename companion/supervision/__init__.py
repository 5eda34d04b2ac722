"""Who flies, and the failsafes."""
