// The field and the time step of a mesh, as text for its file.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_FIELD_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_FIELD_H_

#include <optional>
#include <string>
#include <vector>

namespace isoscope::client {

struct MeshField {
  std::string name = "";
  std::string component = "";  // "": the only one
  std::string unit = "";       // "": unknown
  std::optional<int> step = std::nullopt;
  std::optional<double> time = std::nullopt;
  std::string time_unit = "";  // "": unknown
};

// Returns a line for each fact: "field velocity:x", "unit m/s", "step 3", "time 0.25 s". Control
// characters of names become '?', so that a line stays one.
std::vector<std::string> LinesOf(const MeshField& field);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_FIELD_H_
