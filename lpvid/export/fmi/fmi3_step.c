
/* One step of the model per communication step of @PERIOD@ s, or several; inputs are held meanwhile. */

/** Outputs of the present states and inputs; the states stay. */
static void look(Instance *m)
{
    @NAME@_states ahead = m->s;
    @NAME@_step(&m->p, &ahead, &m->u, &m->y);
}

PLAIN(fmi3EnterStepMode)
REFUSED(fmi3EnterEventMode)

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)instanceEnvironment;
    (void)logMessage;
    return NULL;
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
    return make(instantiationToken, instanceEnvironment, logMessage);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    (void)discreteStatesNeedUpdate;
    (void)terminateSimulation;
    (void)nominalsOfContinuousStatesChanged;
    (void)valuesOfContinuousStatesChanged;
    (void)nextEventTimeDefined;
    (void)nextEventTime;
    return complain((Instance *)instance, "there is no event mode");
}

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
    Instance *m = (Instance *)instance;
    const fmi3Float64 period = @PERIOD@;
    const fmi3Float64 samples = communicationStepSize / period;
    (void)noSetFMUStatePriorToCurrentPoint;
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = currentCommunicationPoint;
    if (!(samples > 0.5) || !(samples < 1e9)) {
        return complain(m, "the communication step is shorter than the model's period");
    }
    const long count = (long)(samples + 0.5);
    const fmi3Float64 off = samples - (fmi3Float64)count;
    if ((off > 1e-6 * samples) || (off < -1e-6 * samples)) {
        return complain(m, "the communication step is no multiple of the model's period, @PERIOD@ s");
    }
    for (long k = 0; k < count; k++) {
        @NAME@_step(&m->p, &m->s, &m->u, &m->y);
    }
    m->time = currentCommunicationPoint + communicationStepSize;
    *lastSuccessfulTime = m->time;
    return fmi3OK;
}

/* Model exchange, which this is not. */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return complain((Instance *)instance, "fmi3EnterContinuousTimeMode is not supported");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    (void)enterEventMode;
    (void)terminateSimulation;
    return complain((Instance *)instance, "fmi3CompletedIntegratorStep is not supported");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    (void)time;
    return complain((Instance *)instance, "fmi3SetTime is not supported");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[], size_t
                                   nContinuousStates)
{
    (void)continuousStates;
    (void)nContinuousStates;
    return complain((Instance *)instance, "fmi3SetContinuousStates is not supported");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t
                                             nContinuousStates)
{
    (void)derivatives;
    (void)nContinuousStates;
    return complain((Instance *)instance, "fmi3GetContinuousStateDerivatives is not supported");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    (void)eventIndicators;
    (void)nEventIndicators;
    return complain((Instance *)instance, "fmi3GetEventIndicators is not supported");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    (void)continuousStates;
    (void)nContinuousStates;
    return complain((Instance *)instance, "fmi3GetContinuousStates is not supported");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t
                                             nContinuousStates)
{
    (void)nominals;
    (void)nContinuousStates;
    return complain((Instance *)instance, "fmi3GetNominalsOfContinuousStates is not supported");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    (void)nEventIndicators;
    return complain((Instance *)instance, "fmi3GetNumberOfEventIndicators is not supported");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    (void)nContinuousStates;
    return complain((Instance *)instance, "fmi3GetNumberOfContinuousStates is not supported");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t
                                        nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns, const
                                        fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t
                                        nSensitivity)
{
    (void)unknowns;
    (void)nUnknowns;
    (void)knowns;
    (void)nKnowns;
    (void)seed;
    (void)nSeed;
    (void)sensitivity;
    (void)nSensitivity;
    return complain((Instance *)instance, "fmi3GetDirectionalDerivative is not supported");
}
