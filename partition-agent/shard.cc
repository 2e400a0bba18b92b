#include "partition-agent/shard.h"
