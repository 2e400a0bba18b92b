#include "core/visibility/occluder_selection.h"
