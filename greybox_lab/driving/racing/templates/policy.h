/* @TITLE@
   Nothing is kept between calls, nothing allocated, nothing called but the mathematical library. */
#ifndef $_H
#define $_H

@SEEN@
@DONE@
#ifdef __cplusplus
extern "C" {
#endif

/* What the policy does who sees that: seen $_NSEEN, action $_NACTION.
   Numbers are scaled and clipped to @LARGEST@ as in learning, actions are clamped. */
void @_act(const double *seen, double *action);

#ifdef __cplusplus
}
#endif

#endif
