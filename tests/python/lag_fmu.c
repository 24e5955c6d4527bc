/* A lag x' = (gain u - x)/lag, y = x + direct u, solved exactly for held commands, as a co-simulation unit of FMI 2.0 and 3.0 in one library. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { U, Y, GAIN, LAG, X, DIRECT, COUNT };

typedef struct {
    double v[COUNT];
} Lag;

static Lag *make(void) {
    Lag *l = calloc(1, sizeof *l);
    if (l) {
        l->v[GAIN] = 2.0;
        l->v[LAG] = 0.5;
    }
    return l;
}

static int put(Lag *l, const unsigned *r, size_t n, const double *x) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= COUNT || r[i] == Y) return 3;
        l->v[r[i]] = x[i];
    }
    return 0;
}

static int get(Lag *l, const unsigned *r, size_t n, double *x) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= COUNT) return 3;
        x[i] = r[i] == Y ? l->v[X] + l->v[DIRECT] * l->v[U] : l->v[r[i]];
    }
    return 0;
}

static int step(Lag *l, double h) {
    double to = l->v[GAIN] * l->v[U];
    if (!(h > 0.0)) return 3;
    l->v[X] = to + (l->v[X] - to) * exp(-h / l->v[LAG]);
    return 0;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
void *fmi2Instantiate(const char *n, int t, const char *g, const char *p, const void *f, int v, int l) { return make(); }
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const k[]) { return 0; }
int fmi2SetupExperiment(void *c, int td, double t, double a, int sd, double b) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2ExitInitializationMode(void *c) { return 0; }
int fmi2Terminate(void *c) { return 0; }
int fmi2Reset(void *c) { return 0; }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *x) { return put(c, r, n, x); }
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *x) { return get(c, r, n, x); }
int fmi2DoStep(void *c, double t, double h, int p) { return step(c, h); }

const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(const char *n, const char *g, const char *p, bool v, bool l, bool e, bool a, const unsigned *r, size_t k, void *w, void *m, void *i) {
    return make();
}
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, bool td, double t, double a, bool sd, double b) { return 0; }
int fmi3ExitInitializationMode(void *c) { return 0; }
int fmi3Terminate(void *c) { return 0; }
int fmi3Reset(void *c) { return 0; }
int fmi3SetFloat64(void *c, const unsigned *r, size_t n, const double *x, size_t k) { return n == k ? put(c, r, n, x) : 3; }
int fmi3GetFloat64(void *c, const unsigned *r, size_t n, double *x, size_t k) { return n == k ? get(c, r, n, x) : 3; }
int fmi3DoStep(void *c, double t, double h, bool p, bool *e, bool *s, bool *y, double *last) {
    *e = *s = *y = false;
    *last = t + h;
    return step(c, h);
}

/* Functions of the standard that this unit does not have; loaders ask for each by its name. */
#define NONE(name) int name(void) { return 3; }
NONE(fmi2CancelStep) NONE(fmi2CompletedIntegratorStep) NONE(fmi2DeSerializeFMUstate) NONE(fmi2EnterContinuousTimeMode)
NONE(fmi2EnterEventMode) NONE(fmi2FreeFMUstate) NONE(fmi2GetBoolean) NONE(fmi2GetBooleanStatus) NONE(fmi2GetContinuousStates)
NONE(fmi2GetDerivatives) NONE(fmi2GetDirectionalDerivative) NONE(fmi2GetEventIndicators) NONE(fmi2GetFMUstate)
NONE(fmi2GetInteger) NONE(fmi2GetIntegerStatus) NONE(fmi2GetNominalsOfContinuousStates) NONE(fmi2GetRealOutputDerivatives)
NONE(fmi2GetRealStatus) NONE(fmi2GetStatus) NONE(fmi2GetString) NONE(fmi2GetStringStatus) NONE(fmi2NewDiscreteStates)
NONE(fmi2SerializeFMUstate) NONE(fmi2SerializedFMUstateSize) NONE(fmi2SetBoolean) NONE(fmi2SetContinuousStates)
NONE(fmi2SetFMUstate) NONE(fmi2SetInteger) NONE(fmi2SetRealInputDerivatives) NONE(fmi2SetString) NONE(fmi2SetTime)
NONE(fmi3ActivateModelPartition) NONE(fmi3CompletedIntegratorStep) NONE(fmi3DeserializeFMUState) NONE(fmi3EnterConfigurationMode)
NONE(fmi3EnterContinuousTimeMode) NONE(fmi3EnterEventMode) NONE(fmi3EnterStepMode) NONE(fmi3EvaluateDiscreteStates)
NONE(fmi3ExitConfigurationMode) NONE(fmi3FreeFMUState) NONE(fmi3GetAdjointDerivative) NONE(fmi3GetBinary) NONE(fmi3GetBoolean)
NONE(fmi3GetClock) NONE(fmi3GetContinuousStateDerivatives) NONE(fmi3GetContinuousStates) NONE(fmi3GetDirectionalDerivative)
NONE(fmi3GetEventIndicators) NONE(fmi3GetFMUState) NONE(fmi3GetFloat32) NONE(fmi3GetInt16) NONE(fmi3GetInt32) NONE(fmi3GetInt64)
NONE(fmi3GetInt8) NONE(fmi3GetIntervalDecimal) NONE(fmi3GetIntervalFraction) NONE(fmi3GetNominalsOfContinuousStates)
NONE(fmi3GetNumberOfContinuousStates) NONE(fmi3GetNumberOfEventIndicators) NONE(fmi3GetNumberOfVariableDependencies)
NONE(fmi3GetOutputDerivatives) NONE(fmi3GetShiftDecimal) NONE(fmi3GetShiftFraction) NONE(fmi3GetString) NONE(fmi3GetUInt16)
NONE(fmi3GetUInt32) NONE(fmi3GetUInt64) NONE(fmi3GetUInt8) NONE(fmi3GetVariableDependencies) NONE(fmi3InstantiateModelExchange)
NONE(fmi3InstantiateScheduledExecution) NONE(fmi3SerializeFMUState) NONE(fmi3SerializedFMUStateSize) NONE(fmi3SetBinary)
NONE(fmi3SetBoolean) NONE(fmi3SetClock) NONE(fmi3SetContinuousStates) NONE(fmi3SetDebugLogging) NONE(fmi3SetFMUState)
NONE(fmi3SetFloat32) NONE(fmi3SetInt16) NONE(fmi3SetInt32) NONE(fmi3SetInt64) NONE(fmi3SetInt8) NONE(fmi3SetIntervalDecimal)
NONE(fmi3SetIntervalFraction) NONE(fmi3SetShiftDecimal) NONE(fmi3SetShiftFraction) NONE(fmi3SetString) NONE(fmi3SetTime)
NONE(fmi3SetUInt16) NONE(fmi3SetUInt32) NONE(fmi3SetUInt64) NONE(fmi3SetUInt8) NONE(fmi3UpdateDiscreteStates)
