#include "core/visibility/occlusion_map.h"
