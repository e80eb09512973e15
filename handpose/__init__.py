"""What is known about hands and depth cameras: facts, data sets, synthetic hands, fitting, predicting, scoring."""
