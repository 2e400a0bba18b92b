// Every message of the streams between coordinator and agents comes as it was sent, or is refused.

#include "proto/message_checksum.h"

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"
#include <grpcpp/support/slice.h>

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "tests/support/status_matchers.h"

namespace isoscope::proto {
namespace {

namespace v1 = isoscope::internal::v1;

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::UnorderedElementsAre;
using Traits = grpc::SerializationTraits<v1::RenderFrameResponse>;

std::string BytesOf(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  std::string bytes;
  for (const grpc::Slice& slice : slices) {
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return bytes;
}

std::string Sent(const v1::RenderFrameResponse& message) {
  grpc::ByteBuffer buffer;
  bool own_buffer = false;
  EXPECT_TRUE(Traits::Serialize(message, &buffer, &own_buffer).ok());
  return BytesOf(buffer);
}

// Returns the receiver's message from bytes that arrive in pieces.
v1::RenderFrameResponse Received(const std::string& bytes, std::size_t piece_size = 1U << 20) {
  std::vector<grpc::Slice> slices;
  for (std::size_t begin = 0; begin < bytes.size(); begin += piece_size) {
    slices.emplace_back(bytes.substr(begin, piece_size));
  }
  grpc::ByteBuffer buffer(slices.data(), slices.size());
  v1::RenderFrameResponse message;
  message.add_bands("what an earlier message left");
  EXPECT_TRUE(Traits::Deserialize(&buffer, &message).ok());
  return message;
}

void ExpectRefused(const std::string& bytes) {
  v1::RenderFrameResponse message = Received(bytes);
  EXPECT_THAT(CheckIntact(message), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_EQ(message.bands_size(), 0) << "nothing of a damaged message is kept";
  EXPECT_EQ(message.message_case(), v1::RenderFrameResponse::MESSAGE_NOT_SET);
}

v1::RenderFrameResponse RayHits() {
  v1::RenderFrameResponse message;
  message.mutable_ray_hits()->mutable_hits()->add_block_id_deltas(300);
  message.add_bands("band");
  return message;
}

TEST(MessageChecksumTest, TheChecksumOfTheMessageStandsBeforeIt) {
  const std::string bytes = Sent(RayHits());
  const std::string plain = RayHits().SerializeAsString();
  ASSERT_EQ(bytes.size(), 4 + plain.size());
  EXPECT_EQ(bytes.substr(4), plain);
  EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(bytes.data()), base::Crc32c(plain));
}

TEST(MessageChecksumTest, MessagesOfEverySizeComeAsTheyWereSentInWhateverPieces) {
  // gRPC writes up to 1 MiB into one slice.
  for (const std::size_t size : {0U, 1U, 20U, 4096U, (1U << 20) - 6, (1U << 20) + 1, 3U << 20}) {
    v1::RenderFrameResponse message;
    if (size > 0) {
      message.add_bands(std::string(size, 'b'));
    }
    const std::string bytes = Sent(message);
    for (const std::size_t piece_size : {1U, 3U, 5U, 8192U, 4U << 20}) {
      if (bytes.size() / piece_size > 100'000) {
        continue;
      }
      const v1::RenderFrameResponse received = Received(bytes, piece_size);
      EXPECT_THAT(CheckIntact(received), IsOk());
      EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(received, message))
          << size << " bytes in pieces of " << piece_size;
    }
  }
}

TEST(MessageChecksumTest, EveryFlippedBitIsFound) {
  const std::string bytes = Sent(RayHits());
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    ExpectRefused(damaged);
  }
}

TEST(MessageChecksumTest, CutLengthenedAndEmptyMessagesAreRefused) {
  const std::string bytes = Sent(RayHits());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    ExpectRefused(bytes.substr(0, size));
  }
  ExpectRefused(bytes + '\0');
  v1::RenderFrameResponse message;
  ParseChecked(nullptr, &message);
  EXPECT_THAT(CheckIntact(message), StatusIs(absl::StatusCode::kUnavailable));
}

TEST(MessageChecksumTest, WithoutAChecksumOrWithBytesThatAreNoMessageItIsRefused) {
  ExpectRefused(RayHits().SerializeAsString());
  const std::string rubbish = "\xff\xff\xff";
  std::string bytes;
  base::AppendLittleEndian(base::Crc32c(rubbish), &bytes);
  ExpectRefused(bytes + rubbish);
}

TEST(MessageChecksumTest, AnObjectThatHeldADamagedMessageTakesTheNextOne) {
  v1::RenderFrameResponse message = Received("damaged");
  ASSERT_THAT(CheckIntact(message), StatusIs(absl::StatusCode::kUnavailable));
  grpc::Slice slice(Sent(RayHits()));
  grpc::ByteBuffer buffer(&slice, 1);
  ASSERT_TRUE(Traits::Deserialize(&buffer, &message).ok());
  EXPECT_THAT(CheckIntact(message), IsOk());
  EXPECT_EQ(message.SerializeAsString(), RayHits().SerializeAsString());
}

template <typename Message>
std::string NameIfChecked() {
  static_assert(std::is_base_of_v<ChecksummedTraits<Message>, grpc::SerializationTraits<Message>>);
  return Message::descriptor()->full_name();
}

TEST(MessageChecksumTest, NoStreamBetweenCoordinatorAndAgentsIsWithout) {
  std::set<std::string> streamed;
  const google::protobuf::ServiceDescriptor* const service =
      v1::RenderFrameRequest::descriptor()->file()->service(0);
  for (int i = 0; i < service->method_count(); ++i) {
    const google::protobuf::MethodDescriptor* const method = service->method(i);
    if (method->client_streaming() || method->server_streaming()) {
      streamed.insert(method->input_type()->full_name());
      streamed.insert(method->output_type()->full_name());
    }
  }
  EXPECT_THAT(streamed, UnorderedElementsAre(NameIfChecked<v1::RenderFrameRequest>(),
                                             NameIfChecked<v1::RenderFrameResponse>(),
                                             NameIfChecked<v1::ExtractSurfaceRequest>(),
                                             NameIfChecked<v1::ExtractSurfaceResponse>()));
}

}  // namespace
}  // namespace isoscope::proto
