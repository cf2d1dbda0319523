"""How well do predictors tell what detectors of their own reach on 41 rigs of docs/findings.md?"""
