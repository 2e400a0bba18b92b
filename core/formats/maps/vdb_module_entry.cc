// isoscope_vdb.so exports these symbols (vdb_series.cc).

#include "core/formats/maps/vdb_child.h"

extern "C" const void* IsoscopeVdbCalls() { return &isoscope::source::VdbCalls(); }
