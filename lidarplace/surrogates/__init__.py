"""The surrogates: formulas, their evaluation, and how far they may be off."""
