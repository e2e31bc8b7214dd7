"""Sources of pictures, one file or folder a scheme, and how a picture is cut out and turned."""
