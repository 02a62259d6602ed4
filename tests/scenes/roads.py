"""A hand-made SUMO network with arbitrary lane ids: two lanes that part at a signal, one ahead, one to the side."""

from pathlib import Path

from pavetwin.world.build import BuildOptions, Built, build_world

_NET = """<net version="1.20"{lefthand}>
  <location netOffset="0,0" convBoundary="0,-100,200,100" origBoundary="0,0,1,1" projParameter="!"/>
  <edge id=":m_0" function="internal">
    <lane id="inside a" index="0" speed="9" length="10" shape="100,{kerb} 110,{kerb}"/>
  </edge>
  <edge id=":m_1" function="internal">
    <lane id="inside b" index="0" speed="9" length="5" shape="100,{middle} 104,{middle}"/>
  </edge>
  <edge id=":m_2" function="internal">
    <lane id="inside c" index="0" speed="9" length="5" shape="104,{middle} 106,{side}"/>
  </edge>
  <edge id="in" from="a" to="m" type="highway.primary" name="Way">
    <lane id="towards-the-middle" index="1" speed="13.9" length="100" shape="0,{middle} 100,{middle}"/>
    <lane id="at-the-kerb" index="0" speed="13.9" length="100" shape="0,{kerb} 100,{kerb}"/>
  </edge>
  <edge id="ahead" from="m" to="b">
    <lane id="x" index="0" speed="13.9" length="90" shape="110,{kerb} 200,{kerb}"/>
  </edge>
  <edge id="aside" from="m" to="c">
    <lane id="y" index="0" speed="13.9" length="88" shape="106,{side} 106,{far}"/>
  </edge>
  <edge id="rails" from="a" to="m">
    <lane id="z" index="0" allow="tram" speed="9" length="90" shape="0,50 100,50"/>
  </edge>
  <junction id="m" type="traffic_light" x="105" y="0" shape="100,-12 110,-12 110,12 100,12"/>
  <connection from="in" to="ahead" fromLane="0" toLane="0" via="inside a" tl="lights" linkIndex="4" dir="s"/>
  <connection from="in" to="aside" fromLane="1" toLane="0" via="inside b" tl="lights" linkIndex="7" dir="{turn}"/>
  <connection from="rails" to="ahead" fromLane="0" toLane="0" tl="lights" linkIndex="1" dir="s"/>
  <connection from=":m_0" to="ahead" fromLane="0" toLane="0" dir="s"/>
  <connection from=":m_1" to="aside" fromLane="0" toLane="0" via="inside c" dir="{turn}"/>
  <connection from=":m_2" to="aside" fromLane="0" toLane="0" dir="{turn}"/>
</net>"""


def net_text(*, left_hand: bool = False) -> str:
    """The `.net.xml`: `in` leads east; its kerb lane goes on to `ahead`, its other lane turns off to `aside`."""
    side = 1 if left_hand else -1
    return _NET.format(
        lefthand=' lefthand="true"' if left_hand else "",
        kerb=side * 3.2,
        middle=0,
        side=-side * 12,
        far=-side * 100,
        turn="r" if left_hand else "l",
    )


def parting_lanes(folder: Path, *, left_hand: bool = False) -> Built:
    """The world of that network."""
    path = folder / "hand.net.xml"
    path.write_text(net_text(left_hand=left_hand), encoding="utf-8")
    return build_world(path, BuildOptions(seed=1))
