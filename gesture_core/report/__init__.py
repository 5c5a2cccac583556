"""Pictures and pages of results: evaluations, explanations of a decision, whole runs."""
