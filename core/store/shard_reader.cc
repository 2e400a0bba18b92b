#include "core/store/shard_reader.h"
