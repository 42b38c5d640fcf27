
const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    Instance *m = (fmuType != @TYPE@)   ? NULL
                  : (functions == NULL) ? make(fmuGUID, NULL, NULL)
                                        : make(fmuGUID, functions->componentEnvironment, functions->logger);
    if (m == NULL) {
        return NULL;
    }
    const char *name = (instanceName != NULL) ? instanceName : "";
    m->title = (char *)malloc(strlen(name) + 1u);
    if (m->title == NULL) {
        free(m);
        return NULL;
    }
    strcpy(m->title, name);
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        free(((Instance *)c)->title);
        free(c);
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    (void)c;
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)c;
    (void)toleranceDefined;
    (void)tolerance;
    (void)startTime;
    (void)stopTimeDefined;
    (void)stopTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    begin((Instance *)c);
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    start((Instance *)c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    return get_values((Instance *)c, vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    return set_values((Instance *)c, vr, nvr, value);
}

#define NONE_GET(kind, type)                                                                                         \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[])               \
    {                                                                                                                \
        (void)vr;                                                                                                    \
        (void)value;                                                                                                 \
        return (nvr == 0u) ? fmi2OK : complain((Instance *)c, "there are real variables only");                      \
    }
#define NONE_SET(kind, type)                                                                                         \
    fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const type value[])         \
    {                                                                                                                \
        (void)vr;                                                                                                    \
        (void)value;                                                                                                 \
        return (nvr == 0u) ? fmi2OK : complain((Instance *)c, "there are real variables only");                      \
    }
NONE_GET(Integer, fmi2Integer)
NONE_GET(Boolean, fmi2Boolean)
NONE_GET(String, fmi2String)
NONE_SET(Integer, fmi2Integer)
NONE_SET(Boolean, fmi2Boolean)
NONE_SET(String, fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    return copy_state((Instance *)c, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    return restore_state((Instance *)c, FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    (void)c;
    return free_state(FMUstate);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    (void)FMUstate;
    (void)size;
    return complain((Instance *)c, "states are not serialized");
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    (void)FMUstate;
    (void)serializedState;
    (void)size;
    return complain((Instance *)c, "states are not serialized");
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    (void)serializedState;
    (void)size;
    (void)FMUstate;
    return complain((Instance *)c, "states are not serialized");
}
