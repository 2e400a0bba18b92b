#include "core/extract/block_extractor.h"
