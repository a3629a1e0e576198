/* FMI 3.0 interface of an identified robot arm; written by dynident @VERSION@, not by hand.
 *
 * Model Exchange and Co-Simulation; no continuous states, no events: torques follow from q, dq, ddq at once@WAY@.
 * Build: this file alone, with the mathematical library. Define FMI3_FUNCTION_PREFIX where several units are linked
 * into one program.
 *
 * This file is data of the identified robot, put into formulas: no licence of dynident covers it.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "@HEADER@"

#ifndef fmi3PlatformTypes_h
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
#endif

#ifndef fmi3FunctionTypes_h
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
#endif

#ifndef FMI3_Export
#if defined(_WIN32)
#define FMI3_Export __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI3_Export __attribute__((visibility("default")))
#else
#define FMI3_Export
#endif
#endif

#ifndef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX
#endif
#define GLUED_(a, b) a##b
#define GLUED(a, b) GLUED_(a, b)
#define NAME(name) GLUED(FMI3_FUNCTION_PREFIX, name)
#define STATUS(name) FMI3_Export fmi3Status NAME(name)

/* Values by value reference: time, then by joint the inputs, then by joint the outputs. */
enum { N = @UPPER@_JOINTS, FIRST = 1 + N * @INPUTS@, COUNT = FIRST + N * @OUTPUTS@ };

enum { BORN = 1, INITIALIZATION = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, ENDED = 32 };

typedef struct {
    double value[COUNT];
    int mode;
    bool exchange, stale;
@MEMORY_FIELD@    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Unit;

static fmi3Status refused(Unit *unit, const char *why)
{
    if (unit->log) {
        unit->log(unit->environment, fmi3Error, "logStatusError", why);
    }
    return fmi3Error;
}

static fmi3Status moved(Unit *unit, int from, int to)
{
    if (!(unit->mode & from)) {
        return refused(unit, "this call is not allowed in this mode");
    }
    unit->mode = to;
    return fmi3OK;
}

static void begin(Unit *unit)
{
    int i;
    for (i = 0; i < COUNT; ++i) {
        unit->value[i] = 0.0;
    }
@STARTS@    unit->mode = BORN;
    unit->stale = true;
@MEMORY_RESET@}

static void evaluate(Unit *unit)
{
    const double *q = unit->value + 1, *dq = q + N, *ddq = dq + N;
@TEMPERATURE@    double *out = unit->value + FIRST, mass[N * N];
    int i, j;
@MEMORY_HERE@    if (!unit->stale) {
        return;
    }
@MEMORY_MOVE@    @LOWER@_inverse_dynamics(q, dq, ddq, @TEMP@@MEMORY@out);
    @LOWER@_gravity(q, out + N);
    @LOWER@_coriolis(q, dq, out + 2 * N);
    @LOWER@_mass_matrix(q, mass);
    for (i = 0; i < N; ++i) {
        out[3 * N + i] = 0.0;
        for (j = 0; j < N; ++j) {
            out[3 * N + i] += mass[N * i + j] * ddq[j];
        }
    }
    @LOWER@_friction(q, dq, ddq, @TEMP@@MEMORY@out + 4 * N);
    @LOWER@_feed_forward(q, dq, ddq, @TEMP@@MEMORY@out + 5 * N);
    unit->stale = false;
}

static Unit *made(fmi3String token, bool exchange, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    Unit *unit;
    if (!token || strcmp(token, "@TOKEN@")) {
        if (log) {
            log(environment, fmi3Error, "logStatusError", "the instantiation token is that of another unit");
        }
        return NULL;
    }
    unit = malloc(sizeof *unit);
    if (unit) {
        unit->exchange = exchange;
        unit->environment = environment;
        unit->log = log;
        begin(unit);
    }
    return unit;
}

FMI3_Export const char *NAME(fmi3GetVersion)(void)
{
    return "3.0";
}

STATUS(fmi3SetDebugLogging)(fmi3Instance unit, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    (void)unit, (void)on, (void)count, (void)categories;
    return fmi3OK;
}

FMI3_Export fmi3Instance NAME(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    return made(token, true, environment, log);
}

FMI3_Export fmi3Instance NAME(fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference intermediate[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)intermediate, (void)update;
    if (events || count) {
        if (log) {
            log(environment, fmi3Error, "logStatusError", "it has no event mode and no intermediate variables");
        }
        return NULL;
    }
    return made(token, false, environment, log);
}

FMI3_Export fmi3Instance NAME(fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    if (log) {
        log(environment, fmi3Error, "logStatusError", "it has no scheduled execution");
    }
    return NULL;
}

FMI3_Export void NAME(fmi3FreeInstance)(fmi3Instance unit)
{
    free(unit);
}

STATUS(fmi3EnterInitializationMode)(fmi3Instance instance, fmi3Boolean bounded, fmi3Float64 tolerance,
                                    fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    Unit *unit = instance;
    (void)bounded, (void)tolerance, (void)ends, (void)stop;
    if (moved(unit, BORN, INITIALIZATION) != fmi3OK) {
        return fmi3Error;
    }
    unit->value[0] = start;
    return fmi3OK;
}

STATUS(fmi3ExitInitializationMode)(fmi3Instance instance)
{
    Unit *unit = instance;
@MEMORY_BEGIN@    return moved(unit, INITIALIZATION, unit->exchange ? EVENT : STEP);
}

STATUS(fmi3EnterEventMode)(fmi3Instance instance)
{
    return moved(instance, CONTINUOUS, EVENT);
}

STATUS(fmi3Terminate)(fmi3Instance instance)
{
    return moved(instance, EVENT | CONTINUOUS | STEP, ENDED);
}

STATUS(fmi3Reset)(fmi3Instance instance)
{
    begin(instance);
    return fmi3OK;
}

STATUS(fmi3GetFloat64)(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                       fmi3Float64 values[], size_t size)
{
    Unit *unit = instance;
    size_t k;
    if (size != count) {
        return refused(unit, "every variable has one value");
    }
    for (k = 0; k < count; ++k) {
        if (references[k] >= COUNT) {
            return refused(unit, "no such value reference");
        }
        if (references[k] >= FIRST) {
            evaluate(unit);
        }
        values[k] = unit->value[references[k]];
    }
    return fmi3OK;
}

STATUS(fmi3SetFloat64)(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                       const fmi3Float64 values[], size_t size)
{
    Unit *unit = instance;
    size_t k;
    if (size != count || unit->mode == ENDED) {
        return refused(unit, "every variable has one value, and none can be set after the end");
    }
    for (k = 0; k < count; ++k) {
        if (references[k] < 1 || references[k] >= FIRST) {
            return refused(unit, "only inputs can be set");
        }
    }
    for (k = 0; k < count; ++k) {
        unit->value[references[k]] = values[k];
        unit->stale = true;
@PLACED@    }
    return fmi3OK;
}

STATUS(fmi3GetFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    Unit *unit = instance, *kept = *state ? *state : malloc(sizeof *kept);
    if (!kept) {
        return refused(unit, "no memory is left");
    }
    *kept = *unit;
    *state = kept;
    return fmi3OK;
}

STATUS(fmi3SetFMUState)(fmi3Instance instance, fmi3FMUState state)
{
    Unit *unit = instance;
    const Unit *kept = state;
    memcpy(unit->value, kept->value, sizeof unit->value);
    unit->mode = kept->mode;
    unit->stale = kept->stale;
@MEMORY_BACK@    return fmi3OK;
}

STATUS(fmi3FreeFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

STATUS(fmi3EvaluateDiscreteStates)(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

STATUS(fmi3UpdateDiscreteStates)(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *ended, fmi3Boolean *nominals,
                                 fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next)
{
    *again = *ended = *nominals = *states = *defined = false;
    *next = 0.0;
    return moved(instance, EVENT, EVENT);
}

STATUS(fmi3EnterContinuousTimeMode)(fmi3Instance instance)
{
    return moved(instance, EVENT, CONTINUOUS);
}

STATUS(fmi3CompletedIntegratorStep)(fmi3Instance instance, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *ended)
{
@UNIT@    (void)final;
    *event = *ended = false;
@KEPT@    return moved(instance, CONTINUOUS, CONTINUOUS);
}

STATUS(fmi3SetTime)(fmi3Instance instance, fmi3Float64 time)
{
    Unit *unit = instance;
    unit->value[0] = time;
    return fmi3OK;
}

STATUS(fmi3DoStep)(fmi3Instance instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean final, fmi3Boolean *event,
                   fmi3Boolean *ended, fmi3Boolean *early, fmi3Float64 *reached)
{
    Unit *unit = instance;
    (void)final;
    *event = *ended = *early = false;
    unit->value[0] = *reached = now + step;
@KEPT_BY_STEP@    return moved(unit, STEP, STEP);
}
