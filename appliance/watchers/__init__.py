"""One watcher a file: each turns a few facts into one Check, and knows no device, no clock, no thread."""
