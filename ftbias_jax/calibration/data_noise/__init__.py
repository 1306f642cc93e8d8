"""The noise of the data matrix D by the gradient of the likelihood, from logs of one tool or several."""
