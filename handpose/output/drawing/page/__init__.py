"""A browser page in one file that shows a body. Its JavaScript, HTML and style are in web/hand."""
