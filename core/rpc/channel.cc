#include "core/rpc/channel.h"
