#include "core/view/view.h"
