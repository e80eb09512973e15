"""Data sets as published: NYU and ICVL, their files and the frames that are scored."""
