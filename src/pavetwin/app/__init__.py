"""The page: `pavetwin app`. A server that starts what the command line can do, and plays what came out in a browser."""
