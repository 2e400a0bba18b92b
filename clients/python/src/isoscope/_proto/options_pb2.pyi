from google.protobuf import descriptor_pb2 as _descriptor_pb2
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor
EFFECT_OPTIONS_FIELD_NUMBER: _ClassVar[int]
VALUE_OPTIONS_FIELD_NUMBER: _ClassVar[int]
effect_options: _descriptor.FieldDescriptor
value_options: _descriptor.FieldDescriptor

class EffectOptions(_message.Message):
    __slots__ = ["help", "title"]
    HELP_FIELD_NUMBER: _ClassVar[int]
    TITLE_FIELD_NUMBER: _ClassVar[int]
    help: str
    title: str
    def __init__(self, title: _Optional[str] = ..., help: _Optional[str] = ...) -> None: ...

class ValueOptions(_message.Message):
    __slots__ = ["default_text", "help", "max", "min"]
    DEFAULT_TEXT_FIELD_NUMBER: _ClassVar[int]
    HELP_FIELD_NUMBER: _ClassVar[int]
    MAX_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    default_text: str
    help: str
    max: float
    min: float
    def __init__(self, min: _Optional[float] = ..., max: _Optional[float] = ..., default_text: _Optional[str] = ..., help: _Optional[str] = ...) -> None: ...
