/* @TITLE@ as the sources beside this one see it. */

#ifndef MODEL_H
#define MODEL_H

#include "@.h"

#define MODEL(name) @_##name
#define TOKEN @TOKEN@

#define NX $_NX
#define NU $_NU
#define NP $_NP
#define NY $_NY
#define MOVING @MOVING@ /* states that move; behind them actuators and relaxed quantities */
#define SETTLES @SETTLES@
#define CONTINUOUS @CONTINUOUS@ /* a differential equation and nothing besides */
#define DELAYED @DELAYED@
#define LATE @LATE@
#define PAST @PAST@
@COMMANDS@

#define START_X {@START_X@}
#define START_U {@START_U@}
#define DELAY_OF {@DELAY_OF@}
#define LATENCY_OF {@LATENCY_OF@}

#define LONGEST_STEP @LONGEST@
#define STABLE @STABLE@ /* longest step times eigenvalue, which is at most STIFF + STIFF_BY_SPEED / speed */
#define STIFF @STIFF@
#define STIFF_BY_SPEED @BY_SPEED@
#define SLOWEST @SLOWEST@
#define SPEED_IS_STATE @SPEED_IS_STATE@
#define SPEED_IS_INPUT @SPEED_IS_INPUT@
#define SPEED @SPEED@

#endif
