#include "core/index/interval_tree_builder.h"
