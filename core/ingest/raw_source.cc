#include "core/ingest/raw_source.h"
