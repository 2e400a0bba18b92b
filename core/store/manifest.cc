#include "core/store/manifest.h"
