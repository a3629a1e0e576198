@@@ head
/* Dynamics of an identified robot arm; written by dynident @VERSION@, not by hand.
 *
 * Robot: @ROBOT@
 * Estimate: method '@METHOD@'; SHA-256 of its export to json:
 *   @DIGEST@
 * Standard parameters: @ORIGIN@.
 * Joints, in the order of all arrays:
@NAMES@
 *
 * C99 or C++11 and later; needs the mathematical library only. No function allocates, prints, or keeps anything.
 * Include it as it is for double. Define @UPPER@_FLOAT before to get float: names then end in f, such as
 * @LOWER@_gravityf. Both may be included in one file.
 *
 * SI units: rad or m, rad/s or m/s, rad/s^2 or m/s^2, N m or N, s; temperatures in degrees Celsius. q, dq, ddq, tau are
 * arrays of @UPPER@_JOINTS. Torques are those of the drives at the joints: tau = M(q) ddq + c(q, dq) + g(q) + friction.
 * Matrices are row-major. Outputs must not overlap inputs. Gravity in the base frame: @GRAVITY@ m/s^2.
 *
 * Self-test: compile this file as C with @UPPER@_SELF_TEST defined and run it.
 *
 * This file is data of the identified robot, put into formulas: no licence of dynident covers it.
 */
#undef @UPPER@_NOW
#if defined(@UPPER@_FLOAT)
#if !defined(@UPPER@_H_FLOAT)
#define @UPPER@_H_FLOAT
#define @UPPER@_NOW
#endif
#elif !defined(@UPPER@_H_DOUBLE)
#define @UPPER@_H_DOUBLE
#define @UPPER@_NOW
#endif

#ifdef @UPPER@_NOW
#include <math.h>

#ifndef @UPPER@_JOINTS
#define @UPPER@_JOINTS @JOINTS@
#define @UPPER@_PARAMETERS @PARAMETERS@
#define @UPPER@_DIGEST "@DIGEST@"
#endif

/* Speed in rad/s (or m/s) over which the sign of Coulomb friction turns in functions that compensate it; where the
 * model has a larger width, that holds. Define it before including this file to choose another. */
#ifndef @UPPER@_VELOCITY_SCALE
#define @UPPER@_VELOCITY_SCALE @SCALE@
#endif

/* Only for this file: type, name of a function, constant, function of the mathematical library. */
#ifdef @UPPER@_FLOAT
#define @UPPER@_REAL float
#define @UPPER@_F(name) @LOWER@_##name##f
#define @UPPER@_M(name) name##f
#else
#define @UPPER@_REAL double
#define @UPPER@_F(name) @LOWER@_##name
#define @UPPER@_M(name) name
#endif
#define @UPPER@_C(value) ((@UPPER@_REAL)(value))

@MEMORY_TYPE@/* State of the momentum observer; begin with @LOWER@_observer_reset. */
typedef struct {
    @UPPER@_REAL integral[@JOINTS@];
    @UPPER@_REAL residual[@JOINTS@];
    int started;@OBSERVER_FIELD@
} @UPPER@_F(observer);

/* The sign of a speed, tanh(v / width) with the larger of two widths; sharp where both are 0. */
static inline @UPPER@_REAL @UPPER@_F(sign_)(@UPPER@_REAL v, @UPPER@_REAL width, @UPPER@_REAL scale)
{
    const @UPPER@_REAL w = width > scale ? width : scale;
    if (w > @UPPER@_C(0.0)) {
        return @UPPER@_M(tanh)(v / w);
    }
    return v > @UPPER@_C(0.0) ? @UPPER@_C(1.0) : (v < @UPPER@_C(0.0) ? @UPPER@_C(-1.0) : @UPPER@_C(0.0));
}

@@@ memory type
/* What friction remembers of the way to a sample. Begin with @LOWER@_memory_reset, then give
 * @LOWER@_memory_step the positions in the order of time, before the functions that take it. @TIME@ */
typedef struct {
    @UPPER@_REAL state[@JOINTS@ * @STATES_OF_DRIVE@];
    @UPPER@_REAL motor[@JOINTS@];
    int started;
} @UPPER@_F(memory);

@@@ memory functions
/* Set the memory back: nothing is known of the way before the next step. */
static inline void @UPPER@_F(memory_reset)(@UPPER@_F(memory) *memory)
{
    static const @UPPER@_REAL start[@STATES_OF_DRIVE@] = {@STATE_STARTS@};
    int i;
    for (i = 0; i < @JOINTS@ * @STATES_OF_DRIVE@; ++i) {
        memory->state[i] = start[i % @STATES_OF_DRIVE@];
    }
    for (i = 0; i < @JOINTS@; ++i) {
        memory->motor[i] = @UPPER@_C(0.0);
    }
    memory->started = 0;
}

/* Move on to the positions of the next sample; the first step begins there. */
static inline void @UPPER@_F(memory_step)(@UPPER@_F(memory) *memory, @IN@q@DT_IN@)
{
    @UPPER@_REAL motor[@JOINTS@];
    int i;
@MOTORS@
    for (i = 0; i < @JOINTS@; ++i) {
        if (memory->started) {
            const @UPPER@_REAL moved = motor[i] - memory->motor[i];
@UPDATES@
        }
        memory->motor[i] = motor[i];
    }
    memory->started = 1;
}

@@@ functions
/* Torque of friction, less the drives' bias; rigid is the torque without friction. */
static inline void @UPPER@_F(drives_)(@IN@q, @IN@dq, @IN@rigid, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL scale,
                                       @UPPER@_REAL *tau)
{
@DRIVES@
}

/* Torque of friction and offsets, as identified; ddq matters only where friction grows with the load. */
static inline void @UPPER@_F(friction)(@IN@q, @IN@dq, @IN@ddq, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL *tau)
{
    @UPPER@_REAL rigid[@JOINTS@] = {0};
    @RIGID_FOR_FRICTION@
    @UPPER@_F(drives_)(q, dq, rigid, @TEMP@@MEMORY@@UPPER@_C(0.0), tau);
}

/* The same with smooth signs, see @UPPER@_VELOCITY_SCALE: a drive that is told this does not chatter at standstill. */
static inline void @UPPER@_F(friction_compensation)(@IN@q, @IN@dq, @IN@ddq, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL *tau)
{
    @UPPER@_REAL rigid[@JOINTS@] = {0};
    @RIGID_FOR_FRICTION@
    @UPPER@_F(drives_)(q, dq, rigid, @TEMP@@MEMORY@@UPPER@_C(@UPPER@_VELOCITY_SCALE), tau);
}

/* Torque of the drives for a motion, as identified: M ddq + c + g + friction. */
static inline void @UPPER@_F(inverse_dynamics)(@IN@q, @IN@dq, @IN@ddq, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL *tau)
{
    @UPPER@_REAL rigid[@JOINTS@];
    int i;
    @UPPER@_F(rigid)(q, dq, ddq, rigid);
    @UPPER@_F(drives_)(q, dq, rigid, @TEMP@@MEMORY@@UPPER@_C(0.0), tau);
    for (i = 0; i < @JOINTS@; ++i) {
        tau[i] += rigid[i];
    }
}

/* Feed-forward for a desired motion: the same with smooth signs. */
static inline void @UPPER@_F(feed_forward)(@IN@q, @IN@dq, @IN@ddq, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL *tau)
{
    @UPPER@_REAL rigid[@JOINTS@];
    int i;
    @UPPER@_F(rigid)(q, dq, ddq, rigid);
    @UPPER@_F(drives_)(q, dq, rigid, @TEMP@@MEMORY@@UPPER@_C(@UPPER@_VELOCITY_SCALE), tau);
    for (i = 0; i < @JOINTS@; ++i) {
        tau[i] += rigid[i];
    }
}

/* Torque that holds the arm still where nothing sticks: gravity, offsets, what repeats with position, less bias. */
static inline void @UPPER@_F(gravity_compensation)(@IN@q, @UPPER@_REAL *tau)
{
    const @UPPER@_REAL still[@JOINTS@] = {0};
    @UPPER@_REAL rigid[@JOINTS@];
    int i;@MEMORY_BEGIN@
    @UPPER@_F(gravity)(q, rigid);
    @UPPER@_F(drives_)(q, still, rigid, @TEMP_ZERO@@MEMORY_ZERO@@UPPER@_C(@UPPER@_VELOCITY_SCALE), tau);
    for (i = 0; i < @JOINTS@; ++i) {
        tau[i] += rigid[i];
    }
}

/* Set the momentum observer back; the next step gives a residual of 0. */
static inline void @UPPER@_F(observer_reset)(@UPPER@_F(observer) *observer)
{
    int i;
    for (i = 0; i < @JOINTS@; ++i) {
        observer->integral[i] = @UPPER@_C(0.0);
        observer->residual[i] = @UPPER@_C(0.0);
    }
    observer->started = 0;@OBSERVER_BEGIN@
}

/* One step of the momentum observer (De Luca and Mattone 2003): the residual follows the torque from outside at each
 * joint as a first-order lag. tau: torque of the drives; gain: 1/s, each above 0; dt: time since the last step in s,
 * not read in the first.
 * r = gain (p - integral of (tau + C' dq - g - friction + r)), implicit in r: stable for every step. */
static inline void @UPPER@_F(observer_step)(@UPPER@_F(observer) *observer, @IN@q, @IN@dq, @IN@tau, @TEMP_IN@@IN@gain,
                                            @UPPER@_REAL dt)
{
    const @UPPER@_REAL still[@JOINTS@] = {0};
    @UPPER@_REAL momentum[2 * @JOINTS@];
    @UPPER@_REAL gravity[@JOINTS@];
    @UPPER@_REAL friction[@JOINTS@];
    int i;
    @UPPER@_F(momentum_)(q, dq, momentum);
    @UPPER@_F(gravity)(q, gravity);
@OBSERVER_STEP@    @UPPER@_F(friction_compensation)(q, dq, still, @TEMP@@OBSERVER_MEMORY@friction);
    if (!observer->started) {
        for (i = 0; i < @JOINTS@; ++i) {
            observer->integral[i] = momentum[i];
            observer->residual[i] = @UPPER@_C(0.0);
        }
        observer->started = 1;
        return;
    }
    for (i = 0; i < @JOINTS@; ++i) {
        const @UPPER@_REAL rate = tau[i] + momentum[@JOINTS@ + i] - gravity[i] - friction[i];
        const @UPPER@_REAL reached = observer->integral[i] + dt * rate;
        observer->residual[i] = gain[i] * (momentum[i] - reached) / (@UPPER@_C(1.0) + gain[i] * dt);
        observer->integral[i] = reached + dt * observer->residual[i];
    }
}
@@@ regressor

/* The base parameters, in SI units:
@BETA_NAMES@
 */
static inline void @UPPER@_F(base_parameters)(@UPPER@_REAL *beta)
{
@BETA@
}

/* Torque that is known and no parameter: rotors and bias of the drives. */
static inline void @UPPER@_F(known_torque)(@IN@ddq, @UPPER@_REAL *tau)
{
@KNOWN@
}

/* Y, @JOINTS@ x @PARAMETERS@, row-major, with tau = Y beta + known torque. */
static inline void @UPPER@_F(regressor)(@IN@q, @IN@dq, @IN@ddq, @TEMP_IN@@MEMORY_IN@@UPPER@_REAL *y)
{
    const @UPPER@_REAL scale = @UPPER@_C(0.0);
    @UPPER@_REAL rigid[@JOINTS@] = {0};
    @RIGID_FOR_FRICTION@
    @UPPER@_F(bodies_)(q, dq, ddq, y);
@COLUMNS@
    (void)scale;
    (void)rigid;@TEMP_VOID@@MEMORY_VOID@
}
@@@ tail

#ifdef @UPPER@_SELF_TEST
#include <stdio.h>

#define @UPPER@_STATES @STATES@

/* By state: @ROWS@. */
static const double @UPPER@_F(reference)[@STATES@][@COUNT@][@JOINTS@] = {
@REFERENCE@
};

int main(void)
{
    static const char *const names[@CHECKS@] = {@CHECK_NAMES@};
    double away[@CHECKS@] = {0};
    double size[@CHECKS@] = {0};
    const double limit = sizeof(@UPPER@_REAL) == sizeof(double) ? 1e-9 : 1e-3;
    int failed = 0;
    int s, i, j, k;@MEMORY_BEGIN@
    for (s = 0; s < @STATES@; ++s) {
        @UPPER@_REAL in[@INPUTS@][@JOINTS@];
        @UPPER@_REAL out[@CHECKS@][@JOINTS@] = {{0}};
        @UPPER@_REAL mass[@JOINTS@ * @JOINTS@];
        for (k = 0; k < @INPUTS@; ++k) {
            for (i = 0; i < @JOINTS@; ++i) {
                in[k][i] = (@UPPER@_REAL)@UPPER@_F(reference)[s][k][i];
            }
        }
@MEMORY_STEP@        @UPPER@_F(inverse_dynamics)(in[0], in[1], in[2], @TEMP_ROW@@MEMORY_ZERO@out[0]);
        @UPPER@_F(gravity)(in[0], out[1]);
        @UPPER@_F(coriolis)(in[0], in[1], out[2]);
        @UPPER@_F(mass_matrix)(in[0], mass);
        for (i = 0; i < @JOINTS@; ++i) {
            for (j = 0; j < @JOINTS@; ++j) {
                out[3][i] += mass[@JOINTS@ * i + j] * in[2][j];
            }
        }
        @UPPER@_F(friction)(in[0], in[1], in[2], @TEMP_ROW@@MEMORY_ZERO@out[4]);
        for (k = 0; k < @CHECKS@; ++k) {
            for (i = 0; i < @JOINTS@; ++i) {
                const double wanted = @UPPER@_F(reference)[s][@INPUTS@ + k][i];
                const double gap = fabs((double)out[k][i] - wanted);
                /* a value that is no number counts as failed */
                away[k] = gap <= away[k] ? away[k] : gap;
                size[k] = fmax(size[k], fabs(wanted));
            }
        }
    }
    for (k = 0; k < @CHECKS@; ++k) {
        const int good = away[k] <= limit * fmax(size[k], 1e-6 * size[0]);
        printf("%s: largest difference %.2g of %.3g, %s\n", names[k], away[k], size[k], good ? "good" : "FAILED");
        failed += !good;
    }
    return failed ? 1 : 0;
}
#endif

#undef @UPPER@_REAL
#undef @UPPER@_F
#undef @UPPER@_M
#undef @UPPER@_C
#endif
