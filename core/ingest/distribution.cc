#include "core/ingest/distribution.h"
