"""Campaigns on any cluster: their files, their tables, how they are flown, told of and compared."""
