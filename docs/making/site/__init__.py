"""The site made from the documents and the code (``make site``); the tests follow every link of it.

hook          what mkdocs.yml names: the files of the site, its navigation, the pages
published     which files are in it: documents, what they link to, and the code
navigation    in which order one finds them
github        the Markdown of GitHub as Python-Markdown wants it
sources       the page of a source file: what its docstring says beside its code
highlighting  the colours of code
folders       the page of a folder: its files, with the first line of each
check         every link and anchor of the finished site leads somewhere
"""
