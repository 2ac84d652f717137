"""What the block `scene` of FetchSlide may say: it is the environment's own scene."""

from slapshot.scenes.settings import SceneSettings


class FetchSlideScene(SceneSettings):
    """Nothing can be changed."""
