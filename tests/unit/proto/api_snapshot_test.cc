// The public protos keep their promise (proto/README.md): what clients of the snapshot use is still
// there, under the same number, of the same type, and with the same meaning to old bytes.

#include <fstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "google/protobuf/descriptor.pb.h"
#include "gtest/gtest.h"

namespace isoscope {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using google::protobuf::DescriptorProto;
using google::protobuf::EnumDescriptorProto;
using google::protobuf::EnumValueDescriptorProto;
using google::protobuf::FieldDescriptorProto;
using google::protobuf::FileDescriptorProto;
using google::protobuf::FileDescriptorSet;
using google::protobuf::MethodDescriptorProto;
using google::protobuf::ServiceDescriptorProto;

constexpr char kPublicPackage[] = "isoscope.v1";
constexpr char kRegenerate[] = "; then run tools/regenerate_api_snapshot.sh";

FileDescriptorSet ReadSet(const char* path) {
  std::ifstream in(path, std::ios::binary);
  EXPECT_TRUE(in.is_open()) << path << ": not found; run tools/regenerate_api_snapshot.sh";
  FileDescriptorSet set;
  EXPECT_TRUE(set.ParseFromIstream(&in)) << path << ": damaged";
  return set;
}

// The public files alone, without comments, as the snapshot holds them.
FileDescriptorSet PublicFilesOf(const FileDescriptorSet& set) {
  FileDescriptorSet files;
  for (const FileDescriptorProto& file : set.file()) {
    if (file.package() == kPublicPackage) {
      FileDescriptorProto* copy = files.add_file();
      *copy = file;
      copy->clear_source_code_info();
    }
  }
  return files;
}

template <typename Container>
auto FindByName(const Container& container, const std::string& name) -> decltype(&container[0]) {
  for (const auto& element : container) {
    if (element.name() == name) {
      return &element;
    }
  }
  return nullptr;
}

template <typename Container>
auto FindByNumber(const Container& container, int number) -> decltype(&container[0]) {
  for (const auto& element : container) {
    if (element.number() == number) {
      return &element;
    }
  }
  return nullptr;
}

// Ranges of messages end after their last number, those of enums at it.
template <typename Type>
bool IsReserved(const Type& type, int number, const std::string& name, int last_offset) {
  bool is_number_reserved = false;
  for (const auto& range : type.reserved_range()) {
    is_number_reserved |= range.start() <= number && number <= range.end() - last_offset;
  }
  bool is_name_reserved = false;
  for (const std::string& reserved : type.reserved_name()) {
    is_name_reserved |= reserved == name;
  }
  return is_number_reserved && is_name_reserved;
}

// Lists the incompatible changes from `before` to `after`; each line has advice.
class Comparison {
 public:
  static std::vector<std::string> Run(const FileDescriptorSet& before,
                                      const FileDescriptorSet& after) {
    Comparison comparison;
    // By name and not by file: moving a message to another file changes nothing on the wire.
    FileDescriptorProto all_before;
    FileDescriptorProto all_after;
    for (const FileDescriptorProto& file : before.file()) {
      Merge(file, &all_before);
    }
    for (const FileDescriptorProto& file : after.file()) {
      Merge(file, &all_after);
    }
    comparison.CompareMessages(kPublicPackage, all_before.message_type(), all_after.message_type());
    comparison.CompareEnums(kPublicPackage, all_before.enum_type(), all_after.enum_type());
    for (const ServiceDescriptorProto& service : all_before.service()) {
      comparison.CompareService(service, FindByName(all_after.service(), service.name()));
    }
    return comparison.problems_;
  }

 private:
  static void Merge(const FileDescriptorProto& from, FileDescriptorProto* into) {
    into->mutable_message_type()->MergeFrom(from.message_type());
    into->mutable_enum_type()->MergeFrom(from.enum_type());
    into->mutable_service()->MergeFrom(from.service());
  }

  template <typename... Parts>
  void Report(const Parts&... parts) {
    problems_.push_back(absl::StrCat(parts...));
  }

  template <typename Messages>
  void CompareMessages(const std::string& scope, const Messages& before, const Messages& after) {
    for (const DescriptorProto& message : before) {
      const std::string name = absl::StrCat(scope, ".", message.name());
      const DescriptorProto* now = FindByName(after, message.name());
      if (now == nullptr) {
        Report("message ", name, " is gone: put it back, clients use it");
        continue;
      }
      CompareMessages(name, message.nested_type(), now->nested_type());
      CompareEnums(name, message.enum_type(), now->enum_type());
      for (const FieldDescriptorProto& field : message.field()) {
        CompareField(name, message, field, *now);
      }
      for (const auto& range : message.reserved_range()) {
        for (int number = range.start(); number < range.end(); ++number) {
          if (const FieldDescriptorProto* reused = FindByNumber(now->field(), number)) {
            Report("field ", name, ".", reused->name(), " takes number ", number,
                   ", which was reserved: give it a new number");
          }
        }
      }
    }
  }

  void CompareField(const std::string& message_name, const DescriptorProto& message,
                    const FieldDescriptorProto& field, const DescriptorProto& now_message) {
    const std::string name = absl::StrCat(message_name, ".", field.name());
    const FieldDescriptorProto* now = FindByNumber(now_message.field(), field.number());
    if (now == nullptr) {
      if (const FieldDescriptorProto* moved = FindByName(now_message.field(), field.name())) {
        Report("field ", name, " was renumbered from ", field.number(), " to ", moved->number(),
               ": give it its old number back");
      } else if (!IsReserved(now_message, field.number(), field.name(), 1)) {
        Report("field ", name, " = ", field.number(), " is gone: put it back, or write `reserved ",
               field.number(), "; reserved \"", field.name(),
               "\";` with a line on what replaced it", kRegenerate);
      }
      return;
    }
    if (now->name() != field.name()) {
      Report("field ", name, " = ", field.number(), " is now called ", now->name(),
             ": give it its old name back, or reserve number and name and take a new number");
    }
    if (now->type() != field.type() || now->type_name() != field.type_name() ||
        now->label() != field.label() || now->proto3_optional() != field.proto3_optional()) {
      Report("field ", name, " = ", field.number(), " changed its type from ", TypeOf(field),
             " to ", TypeOf(*now), ": reserve number and name and add a field with a new number");
    }
    if (OneofOf(message, field) != OneofOf(now_message, *now)) {
      Report("field ", name, " moved from oneof \"", OneofOf(message, field), "\" to \"",
             OneofOf(now_message, *now), "\": move it back, old peers set both");
    }
  }

  static std::string OneofOf(const DescriptorProto& message, const FieldDescriptorProto& field) {
    return field.has_oneof_index() && !field.proto3_optional()
               ? message.oneof_decl(field.oneof_index()).name()
               : "";
  }

  static std::string TypeOf(const FieldDescriptorProto& field) {
    return absl::StrCat(FieldDescriptorProto::Label_Name(field.label()), " ",
                        FieldDescriptorProto::Type_Name(field.type()), " ", field.type_name(),
                        field.proto3_optional() ? " optional" : "");
  }

  template <typename Enums>
  void CompareEnums(const std::string& scope, const Enums& before, const Enums& after) {
    for (const EnumDescriptorProto& type : before) {
      const std::string name = absl::StrCat(scope, ".", type.name());
      const EnumDescriptorProto* now = FindByName(after, type.name());
      if (now == nullptr) {
        Report("enum ", name, " is gone: put it back, clients use it");
        continue;
      }
      for (const EnumValueDescriptorProto& value : type.value()) {
        const EnumValueDescriptorProto* now_value = FindByNumber(now->value(), value.number());
        if (now_value == nullptr) {
          if (!IsReserved(*now, value.number(), value.name(), 0)) {
            Report("enum value ", name, ".", value.name(), " = ", value.number(),
                   " is gone: put it back, or write `reserved ", value.number(), "; reserved \"",
                   value.name(), "\";`", kRegenerate);
          }
        } else if (now_value->name() != value.name()) {
          Report("enum value ", name, ".", value.name(), " = ", value.number(), " is now ",
                 now_value->name(), ": give it its old name back");
        }
      }
    }
  }

  void CompareService(const ServiceDescriptorProto& service, const ServiceDescriptorProto* now) {
    const std::string name = absl::StrCat(kPublicPackage, ".", service.name());
    if (now == nullptr) {
      Report("service ", name, " is gone: put it back, clients call it");
      return;
    }
    for (const MethodDescriptorProto& method : service.method()) {
      const MethodDescriptorProto* now_method = FindByName(now->method(), method.name());
      if (now_method == nullptr) {
        Report("method ", name, ".", method.name(), " is gone: put it back, clients call it");
      } else if (now_method->input_type() != method.input_type() ||
                 now_method->output_type() != method.output_type() ||
                 now_method->client_streaming() != method.client_streaming() ||
                 now_method->server_streaming() != method.server_streaming()) {
        Report("method ", name, ".", method.name(),
               " takes or returns something else: give the new one a new name");
      }
    }
  }

  std::vector<std::string> problems_;
};

class ApiSnapshotTest : public ::testing::Test {
 protected:
  const FileDescriptorSet snapshot_ = ReadSet(ISOSCOPE_API_SNAPSHOT);
  const FileDescriptorSet current_ = PublicFilesOf(ReadSet(ISOSCOPE_DESCRIPTOR_SET));
};

TEST_F(ApiSnapshotTest, NothingClientsUseIsGoneOrChanged) {
  ASSERT_GT(snapshot_.file_size(), 0);
  EXPECT_THAT(Comparison::Run(snapshot_, current_), IsEmpty());
}

TEST_F(ApiSnapshotTest, SnapshotHoldsAllThatIsPublic) {
  // The other way round: what the protos have and the snapshot has not is not watched.
  EXPECT_THAT(Comparison::Run(current_, snapshot_), IsEmpty())
      << "the protos were extended: run tools/regenerate_api_snapshot.sh and commit the snapshot";
}

// The comparison itself: each change to the real protos that breaks clients is seen.
class ApiComparisonTest : public ApiSnapshotTest {
 protected:
  // A copy of the snapshot in which `change` was done to message `name`.
  template <typename Change>
  std::vector<std::string> ProblemsAfter(const std::string& name, Change change) {
    FileDescriptorSet changed = snapshot_;
    bool was_found = false;
    for (FileDescriptorProto& file : *changed.mutable_file()) {
      for (DescriptorProto& message : *file.mutable_message_type()) {
        if (message.name() == name) {
          change(&message);
          was_found = true;
        }
      }
    }
    EXPECT_TRUE(was_found) << name;
    return Comparison::Run(snapshot_, changed);
  }
};

TEST_F(ApiComparisonTest, RemovedFieldIsSeenUnlessReserved) {
  const auto remove_width = [](DescriptorProto* message) {
    ASSERT_EQ(message->field(0).name(), "width_px");
    message->mutable_field()->DeleteSubrange(0, 1);
  };
  EXPECT_THAT(ProblemsAfter("Viewport", remove_width),
              Contains(AllOf(HasSubstr("isoscope.v1.Viewport.width_px"),
                             HasSubstr("reserved 1; reserved \"width_px\";"),
                             HasSubstr("tools/regenerate_api_snapshot.sh"))));
  EXPECT_THAT(ProblemsAfter("Viewport",
                            [&](DescriptorProto* message) {
                              remove_width(message);
                              auto* range = message->add_reserved_range();
                              range->set_start(1);
                              range->set_end(2);
                              message->add_reserved_name("width_px");
                            }),
              IsEmpty());
  EXPECT_THAT(ProblemsAfter("Viewport",
                            [&](DescriptorProto* message) {
                              remove_width(message);
                              message->add_reserved_name("width_px");
                            }),
              Contains(HasSubstr("isoscope.v1.Viewport.width_px")))
      << "the number alone must not be free";
}

TEST_F(ApiComparisonTest, RenumberedRenamedAndRetypedFieldsAreSeen) {
  EXPECT_THAT(
      ProblemsAfter("Viewport",
                    [](DescriptorProto* message) { message->mutable_field(0)->set_number(9); }),
      Contains(HasSubstr("renumbered from 1 to 9")));
  EXPECT_THAT(
      ProblemsAfter("Viewport",
                    [](DescriptorProto* message) { message->mutable_field(0)->set_name("w_px"); }),
      Contains(HasSubstr("now called w_px")));
  EXPECT_THAT(ProblemsAfter("Viewport",
                            [](DescriptorProto* message) {
                              message->mutable_field(0)->set_type(FieldDescriptorProto::TYPE_INT64);
                            }),
              Contains(AllOf(HasSubstr("changed its type"), HasSubstr("TYPE_INT64"))));
  EXPECT_THAT(
      ProblemsAfter("Viewport",
                    [](DescriptorProto* message) {
                      message->mutable_field(0)->set_label(FieldDescriptorProto::LABEL_REPEATED);
                    }),
      Contains(HasSubstr("LABEL_REPEATED")));
  EXPECT_THAT(ProblemsAfter("Camera",
                            [](DescriptorProto* message) {
                              for (FieldDescriptorProto& field : *message->mutable_field()) {
                                field.clear_oneof_index();
                              }
                            }),
              Contains(HasSubstr("moved from oneof \"projection\"")));
}

TEST_F(ApiComparisonTest, EnumValuesServicesAndMessagesAreWatched) {
  FileDescriptorSet changed = snapshot_;
  for (FileDescriptorProto& file : *changed.mutable_file()) {
    for (EnumDescriptorProto& type : *file.mutable_enum_type()) {
      type.mutable_value()->RemoveLast();
    }
    for (ServiceDescriptorProto& service : *file.mutable_service()) {
      service.mutable_method(0)->set_server_streaming(!service.method(0).server_streaming());
    }
    if (file.message_type_size() > 0) {
      file.mutable_message_type()->RemoveLast();
    }
  }
  const std::vector<std::string> problems = Comparison::Run(snapshot_, changed);
  EXPECT_THAT(problems, Contains(HasSubstr("CULLING_NONE = 3 is gone")));
  EXPECT_THAT(problems, Contains(HasSubstr("takes or returns something else")));
  EXPECT_THAT(problems, Contains(HasSubstr("message isoscope.v1.Color is gone")));
}

TEST_F(ApiComparisonTest, AddingIsCompatible) {
  EXPECT_THAT(ProblemsAfter("Viewport",
                            [](DescriptorProto* message) {
                              FieldDescriptorProto* field = message->add_field();
                              field->set_name("scale");
                              field->set_number(3);
                              field->set_type(FieldDescriptorProto::TYPE_DOUBLE);
                            }),
              IsEmpty());
}

}  // namespace
}  // namespace isoscope
