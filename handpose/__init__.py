"""What is known about hands and depth cameras.

Rooms: facts, data, flesh, synthetic, recordings, fitting, predicting, tracking, tracks, scoring, drawing, experiments.
"""
