"""Looking at flights: the report of a log, the live page, the topics that Foxglove draws. Nothing here flies."""
