#include "core/ingest/volume_source.h"
