#include "partition-agent/shard/shard_label_values.h"

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_samples.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::agent {
namespace {

// Neighbouring samples mostly have one label: the list is asked where it changes.
void AddSamples(const volume::BlockSamples& samples, std::size_t count,
                volume::LabelValues* values) {
  volume::VisitScalarType(samples.type, [&]<typename T>() {
    double previous = std::numeric_limits<double>::quiet_NaN();
    for (std::size_t i = 0; i < count && !values->is_done(); ++i) {
      const auto value =
          static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + i * sizeof(T)));
      if (value != previous) {
        values->Add(value);
        previous = value;
      }
    }
  });
}

}  // namespace

absl::StatusOr<volume::LabelValues> LabelValuesOfShards(const Shards& shards, std::size_t max_count,
                                                        const base::Cancellation& cancellation) {
  volume::LabelValues values(max_count);
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader& reader = *shard->reader;
    std::vector<std::uint32_t> ordinals;
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarSpan span,
                                reader.SpanOf(reader.block_id(ordinal)));
      if (span.min < span.max) {
        ordinals.push_back(ordinal);
      } else if (span.min == span.max) {
        values.Add(span.min);
      }
    }
    const auto visit = [&](const volume::BlockSamples& samples) {
      const std::size_t bytes =
          volume::StoredSizeBytes(reader.layout(), samples.block_id, samples.type);
      AddSamples(samples, bytes / volume::SizeOf(samples.type), &values);
      return cancellation.Check();
    };
    for (const store::ShardReader::DiskRun& run : reader.PlanDiskRuns(ordinals)) {
      if (values.is_done()) {
        break;
      }
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      std::string buffer(static_cast<std::size_t>(run.size), '\0');
      ISOSCOPE_RETURN_IF_ERROR(reader.ReadDiskRun(run, ordinals, buffer.data(), visit));
    }
  }
  return values;
}

}  // namespace isoscope::agent
