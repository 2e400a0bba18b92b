// What isoscope_vdb.so exports (vdb_series.cc).

#include "core/source/vdb_child.h"

extern "C" const void* IsoscopeVdbCalls() { return &isoscope::source::VdbCalls(); }
