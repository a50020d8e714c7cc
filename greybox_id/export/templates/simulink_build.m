function @_build()
% @TITLE@
% Compiles the MEX file for @_idnlgrey and the S-function for Simulink.
mex @_mex.c @.c
mex @_sfun.c @.c
end
