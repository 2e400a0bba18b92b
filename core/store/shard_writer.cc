#include "core/store/shard_writer.h"
