#include "core/rpc/grpc_status.h"
