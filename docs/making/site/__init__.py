"""The site made from the documents and the code (``make site``).

hook          what mkdocs.yml names: the files of the site and its pages
published     which files are in it: documents, what they link to, and the code
github        the Markdown of GitHub converted for Python-Markdown
sources       the page of a source file: what it is, what belongs to it, its code
folders       the page of a folder: its files, with the first line of each
"""
