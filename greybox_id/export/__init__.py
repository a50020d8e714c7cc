"""Models for controllers and simulators elsewhere: C, CasADi, acados, ONNX, parameter files."""
