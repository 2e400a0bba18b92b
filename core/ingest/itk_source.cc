#include "core/ingest/itk_source.h"
