# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from msg_adapters.palette import COLOURS, class_colour, class_rgb
from phd_jdtc_ros.study import style


def test_class_colours_differ_and_repeat_after_the_last():
    assert len(set(COLOURS)) == len(COLOURS)
    assert class_colour(len(COLOURS)) == class_colour(0)


def test_class_rgb_is_the_same_colour():
    assert class_rgb(0) == (0.0, 0x72 / 255, 0xB2 / 255)


def test_pictures_use_the_same_colours():
    assert [style.class_colour(k) for k in range(7)] == [class_colour(k) for k in range(7)]
