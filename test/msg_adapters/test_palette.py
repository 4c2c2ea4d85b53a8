from msg_adapters.palette import COLOURS, class_colour, class_rgb
from phd_jdtc_ros.report import style


def test_class_colours_differ_and_repeat_after_the_last():
    assert len(set(COLOURS)) == len(COLOURS)
    assert class_colour(len(COLOURS)) == class_colour(0)


def test_class_rgb_is_the_same_colour():
    assert class_rgb(0) == (0.0, 0x72 / 255, 0xB2 / 255)


def test_pictures_use_the_same_colours():
    assert [style.class_colour(k) for k in range(7)] == [class_colour(k) for k in range(7)]
