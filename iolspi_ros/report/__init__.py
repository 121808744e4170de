"""Reports that people look at: plots, and the page that holds them."""
