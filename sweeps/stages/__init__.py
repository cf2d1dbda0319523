"""The stages of a sweep, a file each: what decides a result, how it is computed, what it holds.

They use neither Ray nor the store nor the grid. What each starts from:

scene -> ground_truth, pog -> surrogates
scene -> recall, accuracy, sampling_error
requirements, which need no scene
scene -> collect -> finetune -> evaluate
scene -> collect -> pretrain (-> finetune) -> evaluate
scene -> collect -> evaluate, by pretrained weights
scene -> collect -> command -> measure: a program of the user instead of a training
scene -> detect, by a trained detector: collect and detect without keeping the clouds

A scene may be recorded in parts; `*logs` are all of them. Where inputs are results of several
stages they are distinguished by their types."""
