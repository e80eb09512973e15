"""What of the documents is made from the code: ``make docs`` writes it, the tests check that
it is current.
"""
