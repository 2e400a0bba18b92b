#include "partition-agent/frame_pipeline.h"
