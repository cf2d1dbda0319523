"""The paper's mathematics: the probabilistic occupancy grid, surrogates, and choice by them."""
