#include "server/frame_coordinator.h"
