"""The networks of the paper's Table 1: training runs, results and the page that shows them."""
