"""T's figures, tables and claims: frozen settings, saved rows, plots and a page made from those."""
