// Members of SourceSamples::request of a volume of a series, which tell it among those that the source
// has (core/indexed/source_request.h).

#ifndef ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_
#define ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_

namespace isoscope::store {

inline constexpr char kFieldMember[] = "volume_field";  // its name
inline constexpr char kComponentMember[] =
    "volume_component";                               // its number; behind the last: magnitude
inline constexpr char kStepMember[] = "volume_step";  // its number

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_
