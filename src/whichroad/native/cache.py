from pathlib import Path
import os
def cache_folder():
    return Path(os.environ["WHICHROAD_CACHE_DIR"])
