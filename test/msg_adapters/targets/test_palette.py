from msg_adapters.targets.palette import COLOURS, class_colour, class_rgb
from phd_jdtc_ros.report import style


def test_class_colours_are_those_of_pictures_and_repeat():
    assert len(set(COLOURS)) == len(COLOURS)
    assert class_colour(len(COLOURS)) == class_colour(0)
    assert class_rgb(0) == (0.0, 0x72 / 255, 0xB2 / 255)
    assert [style.class_colour(k) for k in range(7)] == [class_colour(k) for k in range(7)]
