"""The hand page: one HTML file with a body, which is moved by sliders and by forces.

``assembly`` makes the data of the page and the file. The JavaScript, HTML and CSS in this folder
are also used by the live page (``handpose.output.live.page``) and by the book's pages
(``docs/book/pages``).
"""
