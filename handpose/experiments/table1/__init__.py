"""The networks of the paper's Table 1: trainings, results and the page that shows them."""
