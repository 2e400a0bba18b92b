#include "core/render/renderer_factory.h"
