"""Example libraries, k-nearest neighbours, rejection, the scikit-learn estimator, evaluation."""
