"""Learners on disk: what a checkpoint is, and which are kept while a learner learns."""
