#include "core/mesh/mesh_metrics.h"
