"""The literature's other learners (T chapters 3 and 4), behind the same protocol as IOLSPI."""
