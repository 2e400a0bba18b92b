#include "core/ingest/partitioner.h"
