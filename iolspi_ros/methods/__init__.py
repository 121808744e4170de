"""The literature's other learners (T chapters 3 to 5), and the baseline of all: near-optimal."""
