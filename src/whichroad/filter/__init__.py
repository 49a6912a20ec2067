"""The switching Kalman filter over road hypotheses: compiled kernels over records."""
