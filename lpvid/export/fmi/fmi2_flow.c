
/* Continuous states and their derivatives; there are no events. */

#define STATES (@STATES@u)
#define FIRST_STATE (@FIRST_STATE@u)
#define FIRST_DERIVATIVE (@FIRST_DERIVATIVE@u)

/** Outputs and derivatives at the present states and inputs. */
static void look(Instance *m)
{
    @NAME@_derivatives(&m->p, &m->s, &m->u, &m->dx, &m->y);
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    info->newDiscreteStatesNeeded = fmi2False;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = fmi2False;
    info->nextEventTimeDefined = fmi2False;
    info->nextEventTime = 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    (void)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = fmi2False;
    *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    (void)c;
    (void)time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        *variable(m, FIRST_STATE + i) = (@NAME@_real)x[i];
    }
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        x[i] = (fmi2Real)*variable(m, FIRST_STATE + i);
    }
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    Instance *m = (Instance *)c;
    if (nx != STATES) {
        return complain(m, "another number of states");
    }
    look(m);
    for (fmi2ValueReference i = 0; i < STATES; i++) {
        derivatives[i] = (fmi2Real)*variable(m, FIRST_DERIVATIVE + i);
    }
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    (void)eventIndicators;
    return (ni == 0u) ? fmi2OK : complain((Instance *)c, "there are no event indicators");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    (void)c;
    for (size_t i = 0; i < nx; i++) {
        x_nominal[i] = 1.0;
    }
    return fmi2OK;
}
