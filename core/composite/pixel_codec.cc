#include "core/composite/pixel_codec.h"
