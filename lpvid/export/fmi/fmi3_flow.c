
/* Continuous states and their derivatives; there are no events. */

#define STATES (@STATES@u)
#define FIRST_STATE (@FIRST_STATE@u)
#define FIRST_DERIVATIVE (@FIRST_DERIVATIVE@u)
#define INPUTS (@INPUTS@u)
#define OUTPUTS (@OUTPUTS@u)

/** Outputs and derivatives at the present states and inputs. */
static void look(Instance *m)
{
    @NAME@_derivatives(&m->p, &m->s, &m->u, &m->dx, &m->y);
}

PLAIN(fmi3EnterEventMode)
PLAIN(fmi3EnterContinuousTimeMode)
REFUSED(fmi3EnterStepMode)

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    return make(instantiationToken, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)eventModeUsed;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    (void)instantiationToken;
    (void)instanceEnvironment;
    (void)logMessage;
    return NULL;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    (void)instance;
    (void)nextEventTime;
    *discreteStatesNeedUpdate = fmi3False;
    *terminateSimulation = fmi3False;
    *nominalsOfContinuousStatesChanged = fmi3False;
    *valuesOfContinuousStatesChanged = fmi3False;
    *nextEventTimeDefined = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    (void)instance;
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = fmi3False;
    *terminateSimulation = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    ((Instance *)instance)->time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
    Instance *m = (Instance *)instance;
    if (nContinuousStates != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi3ValueReference i = 0; i < STATES; i++) {
        *variable(m, FIRST_STATE + i) = (@NAME@_real)continuousStates[i];
    }
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    Instance *m = (Instance *)instance;
    if (nContinuousStates != STATES) {
        return complain(m, "another number of states");
    }
    for (fmi3ValueReference i = 0; i < STATES; i++) {
        continuousStates[i] = (fmi3Float64)*variable(m, FIRST_STATE + i);
    }
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
    Instance *m = (Instance *)instance;
    if (nContinuousStates != STATES) {
        return complain(m, "another number of states");
    }
    look(m);
    for (fmi3ValueReference i = 0; i < STATES; i++) {
        derivatives[i] = (fmi3Float64)*variable(m, FIRST_DERIVATIVE + i);
    }
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    (void)eventIndicators;
    return (nEventIndicators == 0u) ? fmi3OK : complain((Instance *)instance, "there are no event indicators");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates)
{
    (void)instance;
    for (size_t i = 0; i < nContinuousStates; i++) {
        nominals[i] = 1.0;
    }
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    (void)instance;
    *nEventIndicators = 0u;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    (void)instance;
    *nContinuousStates = STATES;
    return fmi3OK;
}

/* Co-simulation, which this is not. */

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t nValues)
{
    (void)valueReferences;
    (void)orders;
    (void)values;
    (void)nValues;
    return (nValueReferences == 0u) ? fmi3OK : complain((Instance *)instance, "outputs have no derivatives");
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    (void)currentCommunicationPoint;
    (void)communicationStepSize;
    (void)noSetFMUStatePriorToCurrentPoint;
    (void)eventHandlingNeeded;
    (void)terminateSimulation;
    (void)earlyReturn;
    (void)lastSuccessfulTime;
    return complain((Instance *)instance, "this FMU is for model exchange");
}

/** Whether a variable is an input or a state, with respect to which there are derivatives. */
static int known(fmi3ValueReference vr)
{
    return (vr < INPUTS) || ((vr >= FIRST_STATE) && (vr < (FIRST_STATE + STATES)));
}

/** Whether a variable is an output or the derivative of a state. */
static int unknown(fmi3ValueReference vr)
{
    return ((vr >= INPUTS) && (vr < (INPUTS + OUTPUTS))) ||
           ((vr >= FIRST_DERIVATIVE) && (vr < (FIRST_DERIVATIVE + STATES)));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    Instance *m = (Instance *)instance;
    Instance way;
    memset(&way, 0, sizeof(way));
    if ((nSeed != nKnowns) || (nSensitivity != nUnknowns)) {
        return complain(m, "every variable is a scalar");
    }
    for (size_t i = 0; i < nKnowns; i++) {
        if (known(knowns[i]) == 0) {
            return complain(m, "derivatives are with respect to inputs and states");
        }
        *variable(&way, knowns[i]) = (@NAME@_real)seed[i];
    }
    @NAME@_directional(&m->p, &m->s, &m->u, &way.s, &way.u, &m->dx, &m->y, &way.dx, &way.y);
    for (size_t i = 0; i < nUnknowns; i++) {
        if (unknown(unknowns[i]) == 0) {
            return complain(m, "derivatives are of outputs and of the derivatives of states");
        }
        sensitivity[i] = (fmi3Float64)*variable(&way, unknowns[i]);
    }
    return fmi3OK;
}
