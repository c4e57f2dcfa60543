"""Training of the LS-SVM of `lssvm` on runs of `aqe-sukf`.  Needs scikit-learn and PyWavelets (extra `ml`)."""
