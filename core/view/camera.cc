#include "core/view/camera.h"
