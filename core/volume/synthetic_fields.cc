#include "core/volume/synthetic_fields.h"
