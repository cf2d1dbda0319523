"""Compare predictors with the results of trained detectors on 41 rigs of docs/findings.md."""
