"""What has been seen: scans, the map, what moves, free space."""
