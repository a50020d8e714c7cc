"""Export of models to controllers and simulators: C, CasADi, acados, ONNX, parameter files."""
