"""The surrogates: what each is, what it is computed from, and the result of an evaluation."""
