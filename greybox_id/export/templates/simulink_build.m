function @NAME@_build()
% TITLE
% Compiles the MEX file for @NAME@_idnlgrey and the S-function for Simulink.
mex @NAME@_mex.c @NAME@.c
mex @NAME@_sfun.c @NAME@.c
end
