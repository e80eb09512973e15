"""What is known about hands and depth cameras.

Rooms: facts, data, synthetic, fitting, predicting, scoring, drawing, experiments.
"""
