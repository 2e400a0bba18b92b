#include "core/composite/depth_composite.h"
