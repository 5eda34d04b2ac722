"""The vehicle at the other end of the wire: messages in and reports out, requests in and bytes out."""
