#include "core/rpc/proto_convert.h"
