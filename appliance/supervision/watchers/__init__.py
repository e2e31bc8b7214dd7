"""One watcher a file: is every device and every process still there?"""
