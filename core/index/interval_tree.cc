#include "core/index/interval_tree.h"
