#include "core/image/png_codec.h"
